"""Studies without a server: write a static folder that runs a protocol, and import what its pages recorded.

Modules that only one function needs are imported when it is called.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from minihuman.trust import Permission

if TYPE_CHECKING:
    from minihuman.web.site.record_import import ImportedRecord
    from minihuman.web.site.site_folder import SiteSummary


def write_site(
    protocol: Path | str, out: Path | str, *, collector: str = "download", slots: int = 0, trust: Permission = False
) -> "SiteSummary":
    """Write a static folder that runs a protocol on any web host, without a server.

    Args:
        protocol: the protocol's TOML file.
        out: the folder; files of an earlier site in it are replaced.
        collector: where the pages send their records: "download", "jatos", "datapipe:EXPERIMENT_ID", or an address.
        slots: the number of allocation slots to write; 0 for all participants of the study.
        trust: as for ``run``.

    Raises:
        ProtocolError: if the protocol is not valid, or runs Python that is not trusted.
        MinihumanError: if a part of the protocol needs a server, or there is no such collector.
    """
    from minihuman.admin.protocol_file import read_protocol
    from minihuman.experiment.plan.dry_run import check_worlds
    from minihuman.web.site.site_folder import write_site as write

    study = read_protocol(Path(protocol), trust=trust)
    check_worlds(study, str(protocol))
    return write(study, Path(out), collector=collector, slots=slots)


def import_site_data(
    *paths: Path | str, study: Path | str, protocol: Path | str, trust: Permission = False
) -> Iterator["ImportedRecord"]:
    """Import the records of a site's pages by running each through the session machine, which writes its log.

    The log is marked as consistent, not witnessed. What the page showed and computed is compared with the session
    machine, and every difference is reported. Records that were imported before are skipped.

    Args:
        paths: files of records or of their parts, or folders of them.
        study: the study's folder, which must have the name of the protocol's study; it is created if it is missing.
        protocol: the protocol's TOML file from which the site was written.
        trust: as for ``run``.

    Yields:
        The result for each record. ``error`` explains why a record was refused; the others are still imported.

    Raises:
        MinihumanError: if a path has no records, or the folder has another study's name.
    """
    from minihuman.admin.protocol_file import read_protocol
    from minihuman.web.page_data.page_episodes import list_data_files
    from minihuman.web.site.record_import import import_records

    files = [file for path in paths for file in list_data_files(Path(path))]
    yield from import_records(files, Path(study), read_protocol(Path(protocol), trust=trust))


def describe_site_slots(study: Path | str, protocol: Path | str, *, trust: Permission = False) -> str:
    """Describe in one line how evenly a site's imported records are distributed over its slots and groups.

    Args:
        study: the study's folder.
        protocol: the protocol's TOML file from which the site was written.
        trust: as for ``run``.

    Raises:
        ProtocolError: if the protocol is not valid, or runs Python that is not trusted.
        LogError: if the study's enrolment log cannot be read.
    """
    from minihuman.admin.protocol_file import read_protocol
    from minihuman.web.site.slot_balance import describe_slots

    return describe_slots(Path(study), read_protocol(Path(protocol), trust=trust))
