// A table that is wider than the window is scrolled with the arrow keys, too.
document$.subscribe(() =>
  requestAnimationFrame(() => {
    for (const region of document.querySelectorAll(".md-typeset__scrollwrap")) region.tabIndex = 0
  }),
)

// The galleries: a field above them leaves the worlds whose text has every word that is typed.
document$.subscribe(() => {
  const heading = document.getElementById("all-worlds-in-pictures")
  if (!heading) return
  const field = Object.assign(document.createElement("input"), { type: "search", className: "gallery-filter" })
  field.placeholder = "Filter the worlds: door, FourRooms, pick up"
  field.setAttribute("aria-label", "Filter the worlds")
  heading.after(field)
  const tables = [...document.querySelectorAll(".md-typeset table:has(img)")]
  for (const table of tables) table.classList.toggle("gallery-cells", !table.tHead?.innerText.trim())
  const worlds = tables.flatMap((table) => [
    ...table.querySelectorAll(table.classList.contains("gallery-cells") ? "td" : "tbody tr"),
  ])
  field.addEventListener("input", () => {
    const words = field.value.toLowerCase().split(/\s+/)
    for (const world of worlds) world.hidden = !words.every((word) => world.innerText.toLowerCase().includes(word))
  })
})
