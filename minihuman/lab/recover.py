"""Cut-off and damaged logs made whole again, one after the other: what cannot be helped holds up nothing behind it."""

from collections.abc import Iterable, Iterator
from pathlib import Path

from minihuman.errors import MinihumanError
from minihuman.lab.seal import note_end
from minihuman.log.paths import PART_SUFFIX
from minihuman.log.record.finish import Finished, leftovers, recover, repair


def recover_all(given: Iterable[Path]) -> Iterator[Finished | MinihumanError]:
    """Finish cut-off logs, rewrite damaged finished ones; yield what became of each, or why nothing did.

    ``given`` are logs, or folders to look for cut-off ones in.
    """
    for path in given:
        for log in leftovers(path) if path.is_dir() else [path]:
            try:
                finished = recover(log) if log.name.endswith(PART_SUFFIX) else repair(log)
                if finished.readable:
                    note_end(finished.path)
                yield finished
            except MinihumanError as error:
                yield error
