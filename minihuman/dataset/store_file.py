"""The file that holds a study's tables: the study's own cache if it can hold them, else a temporary file."""

import tempfile
from pathlib import Path

import duckdb

from minihuman.dataset.caches import IN_USE_ERRORS, TABLE_CACHE, remove_cache
from minihuman.dataset.selection import Selection
from minihuman.dataset.sessions import StudySessions
from minihuman.dataset.table_database import CatalogueChangedError, StoreVersionError, TableDatabase
from minihuman.errors import QueryError

_MAX_TRIES = 2  # the file as it is; after its removal, a new file


class StoreFile:
    """Opens the file of a study's tables, and recreates it if its contents are not usable.

    Args:
        sessions: the study's sessions and selection. Their account receives a note when the study's own file is not
            used.
    """

    def __init__(self, sessions: StudySessions) -> None:
        self._sessions = sessions
        self._own = sessions.source / TABLE_CACHE
        self._temporary: tempfile.TemporaryDirectory[str] | None = None

    @property
    def is_temporary(self) -> bool:
        """Return whether the tables lie in a temporary file instead of the study's own."""
        return self._temporary is not None

    def open_database(self, *, read_only: bool) -> TableDatabase:
        """Open the study's own file if it can hold the selection, else a temporary file.

        A new file, or one made by another version of the software, is opened for writing.
        """
        if not self._can_hold_selection():
            return self.open_temporary()
        for _ in range(_MAX_TRIES):
            try:
                return self._open_own(read_only=read_only)
            except (duckdb.IOException, *IN_USE_ERRORS, OSError) as error:  # in use, or a read-only folder
                self.note_unusable_file(error)
                break
            except StoreVersionError:
                if read_only:
                    return self.open_database(read_only=False)
            except CatalogueChangedError:
                self.note(f"{self._own} was changed by another program; its tables were made anew from the logs")
            except duckdb.Error:  # cut off, or no such file
                pass
            try:
                remove_cache(self._own)
            except OSError as error:
                self.note_unusable_file(error)
                break
        return self.open_temporary()

    def open_temporary(self) -> TableDatabase:
        """Open a temporary file for the tables.

        Raises:
            QueryError: if there is no space for the file.
        """
        self._temporary = tempfile.TemporaryDirectory(prefix="minihuman-")
        try:
            return TableDatabase(Path(self._temporary.name) / TABLE_CACHE)
        except duckdb.Error as error:
            self._temporary.cleanup()
            raise self.build_no_space_error(error) from error

    def build_no_space_error(self, error: duckdb.Error) -> QueryError:
        """Return an error which says that neither the study's folder nor the temporary folder can hold the tables."""
        reason = str(error).splitlines()[0]
        return QueryError(
            f"{self._sessions.source}: its tables cannot be made, beside it or in {tempfile.gettempdir()}: {reason}"
        )

    def note_unusable_file(self, error: Exception) -> None:
        """Add a note that the study's own file is not used because of an error."""
        reason = " ".join(str(error).split("\n")[0].split())
        self.note(f"{self._own} cannot be used now ({reason}); the tables were made anew for this once")

    def note_damage(self, count: int) -> None:
        """Add a note that the rows of ``count`` sessions were changed by another program and built again."""
        sessions = "1 session" if count == 1 else f"{count} sessions"
        self.note(f"{self._own} was changed by another program: the rows of {sessions} were made anew from the logs")

    def note(self, line: str) -> None:
        """Add a line to the account's notes, which are shown only in the terminal."""
        self._sessions.account.notes.append(line)

    def close(self) -> None:
        """Remove the temporary file, if there is one."""
        if self._temporary is not None:
            self._temporary.cleanup()

    def _can_hold_selection(self) -> bool:
        """Return whether the study's own file can hold the tables: only under the default selection, with a cache."""
        is_default = self._sessions.selection == Selection()
        return is_default and self._own.parent.is_dir() and not self._sessions.from_logs

    def _open_own(self, *, read_only: bool) -> TableDatabase:
        if not self._own.exists():
            remove_cache(self._own)  # the write-ahead log of a deleted file, which DuckDB would replay into a new one
        return TableDatabase(self._own, read_only=read_only and self._own.exists())
