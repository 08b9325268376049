"""Erase a machine's data of participants who withdrew on any machine, as soon as this machine learns of it.

The code that erases is imported only if there is something to erase, so that `status` starts quickly.
"""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from minihuman.admin.enrolment_entries import ParticipantWithdrawn, open_enrolment_log
from minihuman.admin.erasure_ledger import ErasureLedger
from minihuman.admin.unfinished_withdrawals import find_mark
from minihuman.dataset.withdrawn_codes import LedgerEntry, read_withdrawn_codes
from minihuman.errors import AllocationError, MinihumanError
from minihuman.log.paths import PART_SUFFIX
from minihuman.log.record.file_lock import is_being_recorded
from minihuman.storage.erasure import erase
from minihuman.storage.lease import open_lease_table
from minihuman.storage.study_journals import find_database_url

Listener = Callable[[str], None]


def obey_withdrawals(study_dir: Path, *, ask_store: bool = False, say: Listener = lambda line: None) -> None:
    """Erase this machine's copies of participants who withdrew, and record for all machines that it has done so.

    Args:
        study_dir: the study's folder. If it does not exist, nothing is done, except that the machine is recorded with
            ``ask_store``, because a command that fetches data is about to create the folder.
        ask_store: whether to look for withdrawals in the remote store, too, and erase copies that were stored there
            after them.
        say: called with a line about what was erased, what could not be erased, and what is out of reach.

    Raises:
        OSError: if the enrolment log or the ledger cannot be read or written.
        RemoteStoreError: if the store cannot be reached.
    """
    study_dir = study_dir.absolute()
    if not (study_dir.parent if ask_store else study_dir).is_dir():
        return
    ledger = ErasureLedger(study_dir, ask_store=ask_store, may_be_new=True)
    entries = frozenset[LedgerEntry]()
    new_entries: list[LedgerEntry] = []
    if ledger.is_shared:
        entries = ledger.read()
        new_entries = [LedgerEntry("holds", "", ledger.machine)]
    withdrawn = read_withdrawn_codes(study_dir) | {entry.code for entry in entries if entry.fact == "withdrawn"}
    for code in sorted(withdrawn):
        is_erased = not ledger.is_shared or LedgerEntry("erased", code, ledger.machine) in entries
        if is_erased and not (study_dir / code).exists():
            continue
        if _erase_copy(study_dir, code, ask_store=ask_store, say=say) and ledger.is_shared:
            new_entries += [LedgerEntry("withdrawn", code), LedgerEntry("erased", code, ledger.machine)]
    ledger.add(*new_entries)


def record_erasure(study_dir: Path, code: str) -> None:
    """Record for all machines that a participant has withdrawn, and that this machine has erased their data.

    Raises:
        OSError: if the ledger cannot be written.
        RemoteStoreError: if the store cannot be reached.
    """
    ledger = ErasureLedger(study_dir, ask_store=True)
    if ledger.is_shared:
        machine = ledger.machine
        ledger.add(
            LedgerEntry("holds", "", machine), LedgerEntry("withdrawn", code), LedgerEntry("erased", code, machine)
        )


def erase_local_copy(study_dir: Path, code: str) -> list[Exception]:
    """Erase a participant's logs, the caches that may hold their rows, the record of their arrival, and their leases.

    Returns:
        The errors, empty if everything was erased.
    """
    from minihuman.dataset.caches import list_caches

    errors: list[Exception] = [*erase(study_dir / code)]
    for cache in list_caches(study_dir):  # erased whole, as deleted rows may remain in a file's free pages
        errors += erase(cache)
    for forget in (_forget_arrival, _forget_leases):
        try:
            forget(study_dir, code)
        except (OSError, MinihumanError) as error:
            errors.append(error)
    return errors


def _erase_copy(study_dir: Path, code: str, *, ask_store: bool, say: Listener) -> bool:
    """Erase a participant's data on this machine and report it; return False if anything is left.

    Args:
        study_dir: the study's folder.
        code: the participant's code.
        ask_store: whether to erase their logs and tables in the remote stores, too.
        say: called with a line about what was erased, or why it was not.
    """
    from minihuman.admin.recorded_outputs import withdraw_from_outputs

    if any(is_being_recorded(part) for part in (study_dir / code).rglob(f"*{PART_SUFFIX}")):
        say(f"{code} has withdrawn, but a session of theirs is running here; it is erased once it has ended")
        return False
    has_data = (study_dir / code).exists()
    _record_departure(study_dir, code)
    errors = erase_local_copy(study_dir, code)
    if ask_store:
        errors += _erase_remote_copies(study_dir, code)
    try:
        for line in withdraw_from_outputs(study_dir, code):
            say(line)
    except (OSError, MinihumanError) as error:
        errors.append(error)
    if ask_store and not errors:  # otherwise the stores may still have copies of an interrupted withdrawal
        errors += erase(find_mark(study_dir, code))
    for reason in dict.fromkeys(map(str, errors)):  # one cause can stop several erasures
        say(f"{code} has withdrawn, but not all of their data could be erased: {reason}; run the command again")
    if has_data and not errors:
        say(f"{code} has withdrawn: their data were erased on this machine")
    return not errors


def _erase_remote_copies(study_dir: Path, code: str) -> list[Exception]:
    """Erase a participant's logs and tables from their remote stores; return the errors, empty if all were erased."""
    from minihuman.admin.remote_logs import delete_remote_logs
    from minihuman.dataset.remote_tables import delete_remote_tables

    errors: list[Exception] = []
    for erase_remotely in (delete_remote_logs, delete_remote_tables):
        try:
            erase_remotely(study_dir, code)
        except (OSError, MinihumanError) as error:
            errors.append(error)
    return errors


def _record_departure(study_dir: Path, code: str) -> None:
    """Record a participant's withdrawal in this machine's enrolment log, unless it is there or they have no slot.

    Nothing is done if the study has no enrolment log here, or has it in a database.
    """
    from minihuman.admin.enrolment_log import record_departure
    from minihuman.storage.system import now_text

    journal = open_enrolment_log(study_dir)
    if find_database_url(study_dir) or not journal.begun:
        return
    withdrawn = {line.withdrawn for line in journal.read() if isinstance(line, ParticipantWithdrawn)}
    if code not in withdrawn:
        with suppress(AllocationError):  # the participant has no slot in this log
            record_departure(
                study_dir, ParticipantWithdrawn(code, now_text(), "erased", "withdrawn on another machine")
            )


def _forget_arrival(study_dir: Path, code: str) -> None:
    from minihuman.admin.recruitment import Recruitment

    Recruitment(study_dir).forget(code)


def _forget_leases(study_dir: Path, code: str) -> None:
    leases = open_lease_table(study_dir)
    if leases is not None:
        leases.forget(f"{study_dir.absolute().name}/{code}/")
