"""What every screen is drawn with: colours that read well in a dim room."""

Colour = tuple[int, int, int]

# Contrast against BACKGROUND (WCAG): INK 14.4, QUIET 6.6, ACCENT 8.5. LIT and ACCENT stay apart in every kind of colour
# vision (Okabe and Ito 2008: sky blue and orange).
BACKGROUND: Colour = (22, 25, 30)
SURFACE: Colour = (38, 43, 51)
EDGE: Colour = (84, 93, 105)
INK: Colour = (232, 230, 225)
QUIET: Colour = (154, 164, 176)
ACCENT: Colour = (240, 176, 72)
LIT: Colour = (86, 180, 233)
GOOD: Colour = (0, 190, 140)
BAD: Colour = (232, 110, 60)
