from minihuman.display.drawing.sheet import HIGHLIGHT, Sheet


def draw_taps(screen, size_px):
    sheet = Sheet(size_px, screen.locale)
    sheet.draw.rectangle((0, 0, 20 * screen.taps, 20), fill=HIGHLIGHT)
    return sheet
