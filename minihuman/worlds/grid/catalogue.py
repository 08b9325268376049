"""The table of grid worlds."""

from minihuman.worlds.entry import Entry

ENTRIES: tuple[Entry, ...] = (
    Entry(
        "MiniGrid-FourRooms-v0",
        "minihuman.worlds.grid.env:make",
        {"family": "four_rooms"},
        summary="reach the goal",
        guards_itself=True,
    ),
    Entry("MiniGrid-GoToObj-Transfer-v0", "minihuman.worlds.grid.transfer:GoToObj", summary="go to the {} {}, the 3D one's pair"),
)
