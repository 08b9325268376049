import re
from pathlib import Path

TUTORIAL = Path(__file__).parents[3] / "docs" / "first-person-worlds.md"


def test_the_tutorials_code_runs_from_top_to_bottom(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", TUTORIAL.read_text(), re.DOTALL)
    assert len(blocks) == 11
    names = {"__name__": "tutorial"}
    for block in blocks:
        exec(compile(block, str(TUTORIAL), "exec"), names)  # one after another, as a reader would
    said = capsys.readouterr().out
    assert "an opening from z = 2 to 7 does not fit in the wall" in said
    assert "which is 5 m long" in said
    assert "(60, 80, 3) use the key to open the door and then get to the goal" in said
