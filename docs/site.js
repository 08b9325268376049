// A table that is wider than the window is scrolled with the arrow keys, too.
document$.subscribe(() =>
  requestAnimationFrame(() => {
    for (const region of document.querySelectorAll(".md-typeset__scrollwrap")) region.tabIndex = 0
  }),
)
