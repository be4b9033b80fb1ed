"""Files of a job as results of the public functions: written on request, or held in a temporary folder."""

import shutil
import tempfile
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from stridelab.library.options import data_frame
from stridelab.schemas.base import Contract

if TYPE_CHECKING:
    from stridelab.service.kinds.base import ArtifactFile


@dataclass(frozen=True)
class JobFiles:
    """The temporary folder with the files of a job; it is deleted with this object, and ``save`` copies it."""

    table: ClassVar[str]
    """Name of the Parquet file that ``to_dataframe`` reads."""

    folder: Path

    def __post_init__(self) -> None:
        """Delete the folder with this object."""
        weakref.finalize(self, shutil.rmtree, self.folder, ignore_errors=True)

    def save(self, folder: str | Path, *, replace: bool = False) -> Path:
        """Copy the files of the job into a folder.

        Raises:
            Conflict: ``output-exists`` where the folder exists; ``replace`` allows it for an earlier result.
        """
        from stridelab.service.local_runs import result_folder

        with result_folder(Path(folder), force=replace) as made:
            shutil.copytree(self.folder, made, dirs_exist_ok=True)
        return Path(folder)

    def to_dataframe(self) -> Any:
        """The main table of the job.

        Raises:
            Unavailable: ``dataframe-unavailable`` where neither pandas nor polars is installed.
        """
        import pyarrow.parquet as pq

        table = pq.read_table(self.folder / self.table)
        return data_frame({name: table.column(name).to_numpy() for name in table.column_names})


@contextmanager
def job_folder() -> Iterator[Path]:
    """An empty temporary folder for ``JobFiles``, deleted if the block fails."""
    folder = Path(tempfile.mkdtemp(prefix="stridelab-"))
    try:
        yield folder
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise


def write_job_files(
    folder: str | Path,
    kind: str,
    request: Contract,
    summary: Contract,
    citation_keys: tuple[str, ...],
    write: "Callable[[Path], tuple[ArtifactFile, ...]]",
    *,
    replace: bool,
) -> Path:
    """Write a job's artifacts, by ``write``, and its ``result.json`` into a new folder.

    Raises ``Conflict`` (``output-exists``) where the folder exists; ``replace`` allows it for an earlier result.
    """
    from stridelab.service.kinds.base import Outcome
    from stridelab.service.local_runs import result_folder, write_result

    with result_folder(Path(folder), force=replace) as made:
        write_result(made, kind, request, Outcome(summary.model_dump(mode="json"), citation_keys, write(made)))
    return Path(folder)
