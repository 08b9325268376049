"""The erasure ledger: which machines hold a study's data, who withdrew, and which machine has erased whose data.

The ledger is in the study's database, else in the store that ``logs.url`` names; a study with neither is on one machine
and has no ledger. Machines only add entries, in any order: each entry is written once and never changed. The store's
entries are copied to the data folder, for commands that do not contact the store.
"""

import re
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path

import msgspec

from minihuman.dataset.withdrawn_codes import LEDGER_FILE_NAME, LedgerEntry, read_local_ledger, read_withdrawn_codes
from minihuman.storage.file_journal import FileJournal
from minihuman.storage.journal import Journal
from minihuman.storage.machine_identity import read_machine_id
from minihuman.storage.remote_store import RemoteStore, RemoteStoreConflictError, open_remote_store
from minihuman.storage.study_journals import find_database_url, open_journal

STORE_FOLDER = "withdrawals"  # below the study, in the store of logs
_ALL = "all"  # stands in a stored entry's name for no participant or no machine
_ENTRY_NAME = re.compile(r"(holds|withdrawn|erased|lost)/((?:sub|model)-[0-9]{2,9}|all)/([0-9a-f]{16}|all)", re.ASCII)
SHOWN_DIGITS = 8  # first digits of a machine's number that messages show


class ErasureLedger:
    """The erasure ledger of one study, as one of its machines reads and writes it.

    Args:
        study_dir: the study's folder in the data folder.
        ask_store: whether to read and write the entries in the store, too; without effect if the ledger is in a
            database.
        may_be_new: whether the store may be a new folder, as for ``open_store_url``.

    Raises:
        RemoteStoreError: if the store is a folder that does not exist.
    """

    def __init__(self, study_dir: Path, *, ask_store: bool, may_be_new: bool = False) -> None:
        self._study_dir = study_dir.absolute()
        self._data = self._study_dir.parent
        self._study = self._study_dir.name
        self._in_database = bool(find_database_url(self._study_dir))
        if ask_store and not self._in_database:
            self._store = open_remote_store(self._data, may_be_new=may_be_new)
        else:
            self._store = None

    @property
    def is_shared(self) -> bool:
        """Return whether other machines can read the entries that this machine writes."""
        return self._in_database or self._store is not None

    @property
    def machine(self) -> str:
        """Return this machine's number."""
        return read_machine_id(self._data)

    def read(self) -> frozenset[LedgerEntry]:
        """Read all entries, after copying those that only the store has to the data folder.

        Raises:
            OSError: if the database cannot be reached, or a file cannot be read.
            RemoteStoreError: if the store cannot be reached.
        """
        if self._in_database:
            return frozenset(self._open_shared_journal().read())
        local = frozenset(read_local_ledger(self._data, self._study))
        if self._store is None:
            return local
        stored = frozenset(_list_stored_entries(self._store, self._study))
        self._write_locally(stored - local)
        return local | stored

    def add(self, *entries: LedgerEntry) -> None:
        """Add entries that the ledger does not have yet, for all machines to read.

        Raises:
            OSError: if they cannot be written.
            RemoteStoreError: if the store cannot be reached.
        """
        if not entries:
            return
        existing = self.read()
        new = [entry for entry in dict.fromkeys(entries) if entry not in existing]
        if not new:
            return
        if self._in_database:
            with self._open_shared_journal().hold() as journal:
                journal.append(*(entry for entry in new if entry not in journal.lines))
            return
        self._write_locally(new)
        if self._store is not None:
            _store_entries(self._store, self._study, new)

    def _write_locally(self, entries: Iterable[LedgerEntry]) -> None:
        """Append entries to the ledger file in the data folder, which all studies there share."""
        ordered = sorted(entries, key=lambda entry: (entry.fact, entry.code, entry.machine))
        if ordered:
            path = self._data / LEDGER_FILE_NAME
            with FileJournal(path, _decode_local, mode=0o600).hold() as journal:
                journal.append(*(msgspec.structs.replace(entry, study=self._study) for entry in ordered))

    def _open_shared_journal(self) -> Journal[LedgerEntry]:
        return open_journal(self._study_dir, LEDGER_FILE_NAME, _decode_shared)


def _decode_local(line: bytes, number: int) -> LedgerEntry | None:
    try:
        return msgspec.json.decode(line, type=LedgerEntry)
    except msgspec.DecodeError:  # a line that a crash cut off
        return None


def _decode_shared(line: bytes, number: int) -> LedgerEntry | None:
    """Decode a line of the database; return None for a line that is not a valid entry."""
    entry = _decode_local(line, number)
    if entry is None or not _ENTRY_NAME.fullmatch(_format_entry_name(entry)):
        return None
    return entry


def _format_entry_name(entry: LedgerEntry) -> str:
    return f"{entry.fact}/{entry.code or _ALL}/{entry.machine or _ALL}"


def _list_stored_entries(store: RemoteStore, study: str) -> Iterable[LedgerEntry]:
    """Yield the ledger's entries in a store; files with other names are skipped."""
    prefix = f"{study}/{STORE_FOLDER}/"
    for name in store.names(prefix):
        match = _ENTRY_NAME.fullmatch(name.removeprefix(prefix))
        if match is None:
            continue
        fact, code, machine = match.groups()
        if code == _ALL:
            code = ""
        if machine == _ALL:
            machine = ""
        yield LedgerEntry(fact, code, machine)


def _store_entries(store: RemoteStore, study: str, entries: Iterable[LedgerEntry]) -> None:
    """Store each ledger entry of a study as a file whose name contains the whole entry.

    An existing file is left as it is.
    """
    with tempfile.TemporaryDirectory(prefix="minihuman-") as folder:
        path = Path(folder, "entry")
        path.write_text("An entry of minihuman's erasure ledger; its name says all.\n", encoding="utf-8", newline="\n")
        for entry in entries:
            try:
                store.put(f"{study}/{STORE_FOLDER}/{_format_entry_name(entry)}", path)
            except RemoteStoreConflictError:  # another machine has just written the same entry
                continue


def find_pending_machines(study_dir: Path) -> tuple[str, ...]:
    """Return a line for each machine that has not erased its copy of a participant who withdrew.

    If the ledger is in a store, the result is as of the last ``minihuman gather`` on this machine.

    Raises:
        OSError: if the ledger is in a database that cannot be reached.
    """
    entries = ErasureLedger(study_dir, ask_store=False).read()
    if not entries:
        return ()
    pending = _list_pending(entries, read_withdrawn_codes(study_dir))
    return tuple(_describe_pending(study_dir, machine, codes) for machine, codes in pending.items())


def _list_pending(entries: frozenset[LedgerEntry], withdrawn: frozenset[str]) -> dict[str, list[str]]:
    """Return the codes of the participants whose data a machine has not erased, by the number of each such machine.

    Args:
        entries: the entries of the ledger; machines that are declared lost are left out.
        withdrawn: the codes of the participants who withdrew.
    """
    lost = {entry.machine for entry in entries if entry.fact == "lost"}
    machines = {entry.machine for entry in entries if entry.fact == "holds"} - lost
    erased = {(entry.machine, entry.code) for entry in entries if entry.fact == "erased"}
    pending = {}
    for machine in sorted(machines):
        codes = [code for code in sorted(withdrawn) if (machine, code) not in erased]
        if codes:
            pending[machine] = codes
    return pending


def _describe_pending(study_dir: Path, machine: str, codes: list[str]) -> str:
    number = machine[:SHOWN_DIGITS]
    return (
        f"machine {number} has not erased {', '.join(codes)} yet; run `minihuman gather` there or, if that machine no "
        f"longer exists, `minihuman gather {study_dir} --lost-machine {number}` here"
    )


def declare_machine_lost(study_dir: Path, digits: str, *, say: Callable[[str], None] = lambda line: None) -> None:
    """Stop waiting for a machine that no longer exists, or whose copy was deleted by hand.

    Args:
        study_dir: the study's folder.
        digits: the first digits of the machine's number, as ``status`` shows them.
        say: called with a line about what was done.

    Raises:
        AllocationError: if no machine, or more than one, has such a number.
    """
    from minihuman.errors import AllocationError

    ledger = ErasureLedger(study_dir, ask_store=True)
    machines = {entry.machine for entry in ledger.read() if entry.fact == "holds" and entry.machine.startswith(digits)}
    if len(machines) != 1:
        raise AllocationError(
            f"{len(machines)} machines of {study_dir.name} have a number that begins with {digits!r}; "
            "`minihuman status` shows the numbers"
        )
    (machine,) = machines
    ledger.add(LedgerEntry("lost", "", machine))
    say(f"machine {machine[:SHOWN_DIGITS]} is lost: a withdrawal no longer waits for it")
