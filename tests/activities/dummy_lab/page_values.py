def build_page_values(screen, number):
    return {"taps": screen.taps}
