import gymnasium

import minihuman
from minihuman.worlds.catalogue import ENTRIES


def test_importing_registers_every_world():
    assert minihuman.__version__
    assert all(entry.id in gymnasium.registry for entry in ENTRIES)
