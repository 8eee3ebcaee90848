"""``facestage batch``: fits of many photos and films, on many processes and machines."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from copy import copy
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from facestage.cli import streams
from facestage.cli.film_options import add_film_options
from facestage.cli.photo_options import add_photo_options
from facestage.contract.errors import EXIT_DONE, EXIT_SOME_FAILED, InputError
from facestage.system.cores import use_algebra_threads

if TYPE_CHECKING:
    from facestage.batch.manifest import ManifestRow
    from facestage.batch.task import Task

MANIFEST = ".csv"
# Of the options of photos, those that are no film's.
PHOTOS_ALONE = (
    "landmarks",
    "lights",
    "environment",
    "surround",
    "white_balance",
    "skin_tone",
    "texture_size",
    "light_color",
    "face_region",
    "plan",
)
CHUNK, CHUNK_MIN, CHUNK_MAX = 240, 24, 100_000  # frames


def add_command(commands: Any) -> None:
    """Add ``batch`` to the commands."""
    batch = commands.add_parser(
        "batch",
        help="fit many photos and films, on many processes or machines",
        description="Fit many photos, each on its own, and follow films, on processes of this "
        "machine or on a cluster of Dask. A photo that cannot be fitted, or a process that dies, "
        "never stops the rest. Exit code 5 says that some rows have no result.",
        epilog="Example: facestage batch photos.csv --out fitted, or facestage batch folder "
        "'more/*.jpg' take.mp4 --out fitted --budget draft --workers 2. The manifest's first line "
        "names its columns: photo (several of one person with ; between them) or film (a video, or "
        "a folder of frames), and any of name and the options below, with _ for -; an empty cell "
        "means the command line's. Its paths are relative to it. The folder gets fits/NAME for "
        "each row, summary.csv, report.html and batch.jsonl; docs/batch.md describes them. Ctrl+C "
        "keeps what is done, --resume goes on.",
    )
    batch.add_argument(
        "photos",
        nargs="+",
        type=Path,
        metavar="MANIFEST.csv|PHOTO|VIDEO|FOLDER",
        help="one manifest; or photos, folders of photos, videos and patterns ('photos/*.jpg')",
    )
    batch.add_argument("--out", type=Path, required=True, metavar="DIR", help="the folder to write")
    batch.add_argument(
        "--workers",
        type=int,
        metavar="N",
        help="processes on this machine (default: as many as cores and memory allow)",
    )
    batch.add_argument(
        "--memory",
        type=float,
        metavar="GIB",
        help="at most so much memory for each of them; one that takes more is ended and its photo "
        "tried again (default: its share of the machine's)",
    )
    batch.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="of a running Dask cluster instead of processes here, as tcp://192.168.1.5:8786; its "
        "workers need this version of Facestage, and must see the files under the same paths",
    )
    batch.add_argument(
        "--retries",
        type=int,
        default=2,
        metavar="N",
        help="how often a row is tried again when its process dies (default 2)",
    )
    add_photo_options(batch)
    films = batch.add_argument_group("of films")
    add_film_options(films)
    films.add_argument(
        "--chunk",
        type=int,
        default=CHUNK,
        metavar="FRAMES",
        help="a film of more frames is followed in pieces of so many at most, each by a process of "
        f"its own, and joined (default {CHUNK})",
    )
    batch.add_argument(
        "--resume", action="store_true", help="leave what an earlier batch into --out has done"
    )
    batch.add_argument(
        "--json", action="store_true", help="tell of the progress in JSON on a terminal, too"
    )
    batch.set_defaults(run=run, cancelled=cancelled)


def run(options: argparse.Namespace) -> int:
    """Fit all rows, telling of the progress on standard output."""
    # A process for each core.
    use_algebra_threads(1)
    from facestage.batch.cluster import Pool
    from facestage.batch.run import counted, run_batch
    from facestage.batch.task import Readers
    from facestage.cli.film_options import read_request
    from facestage.cli.jobs import read_jobs
    from facestage.cli.terminal import ProgressLine, listener
    from facestage.contract.batch import SUMMARY
    from facestage.contract.result_files import REPORT

    pool = Pool(options.scheduler, options.workers, options.memory, options.retries)
    tasks = read_tasks(options)
    with listener(options.json) as emit:
        readers = Readers(read_jobs, read_request)
        rows = run_batch(tasks, readers, options.out, pool, options.resume, emit)
    failed = [row for row in rows if row.failed]
    for row in failed:
        photos = ", ".join(Path(photo).name for photo in row.photos)
        streams.say(f"{row.name} ({photos}): {row.sentence}")
    if isinstance(emit, ProgressLine):
        print(f"{counted(rows)}\n\nTable:  {options.out / SUMMARY}")
        print(f"Report: {options.out / REPORT}")
    return EXIT_SOME_FAILED if failed else EXIT_DONE


def cancelled(options: argparse.Namespace) -> str:
    """What a stopped batch says."""
    from facestage.contract.batch import read_journal

    done = sum(not row.failed for row in read_journal(options.out).values())
    if not done:
        return "cancelled before the first row was fitted; run it again, or with --resume."
    return f"cancelled; fitted so far: {done}. --resume goes on with the rest."


class RowParser(argparse.ArgumentParser):
    """Parses what a row says of its photos, or of its film. Raises InputError."""

    def __init__(self, film: bool) -> None:
        super().__init__(add_help=False, allow_abbrev=False)
        self.film = film
        add_photo_options(self)
        if film:
            add_film_options(self)
        self.options = {
            action.dest: action
            for action in self._actions
            if action.option_strings and not (film and action.dest in PHOTOS_ALONE)
        }

    @property
    def columns(self) -> list[str]:
        """What a cell may say."""
        return [name for name, action in self.options.items() if action.nargs != 0]

    def error(self, message: str) -> NoReturn:
        """Raise InputError instead of ending the program."""
        raise InputError(message)

    def shared(self, options: argparse.Namespace) -> argparse.Namespace:
        """What the command line says of every row, its paths from here."""
        shared = self.parse_args([])
        for name in self.options:
            setattr(shared, name, _absolute(name, getattr(options, name), Path.cwd()))
        return shared


def read_tasks(options: argparse.Namespace) -> list[Task]:
    """A task for each row that a ``batch`` command line asks for. Raises InputError."""
    from facestage.batch.manifest import find_photos, read_manifest

    if not CHUNK_MIN <= options.chunk <= CHUNK_MAX:
        raise InputError(f"--chunk is {options.chunk}; expected {CHUNK_MIN} to {CHUNK_MAX}.")
    given = options.photos
    manifests = [path for path in given if path.suffix.lower() == MANIFEST]
    if not manifests:
        rows = find_photos(given)
        try:
            return _tasks(rows, options, Path.cwd())
        except RowError as error:
            name = rows[error.line - 1].photos[0]
            raise InputError(f"For '{name}' {error}; leave all but one out.") from error
    if len(given) > 1:
        raise InputError(
            f"The manifest '{manifests[0]}' was given beside other files; give one manifest, or "
            "photos, videos and folders."
        )
    (manifest,) = manifests
    columns = {name for film in (False, True) for name in RowParser(film).columns}
    rows = read_manifest(manifest, columns)
    try:
        return _tasks(rows, options, manifest.absolute().parent)
    except RowError as error:
        raise InputError(
            f"Line {error.line} of the manifest '{manifest}' cannot be used: {error}; correct it."
        ) from error


class RowError(Exception):
    """What is wrong with the options of a row, as a clause."""

    def __init__(self, line: int, clause: str) -> None:
        super().__init__(clause)
        self.line = line


def _tasks(rows: Sequence[ManifestRow], options: argparse.Namespace, folder: Path) -> list[Task]:
    from facestage.batch.task import Task

    parsers = RowParser(film=False), RowParser(film=True)
    shared = [parser.shared(options) for parser in parsers]
    _check_used(parsers, options, {row.film for row in rows})
    tasks = []
    for number, row in enumerate(rows, 1):
        own = _row_options(row, parsers[row.film], copy(shared[row.film]), folder)
        paths = tuple(folder / photo for photo in row.photos)
        if row.film:
            own.film, own.chunk = paths[0], options.chunk
            for name in ("camera", "focal_px", "truth"):
                setattr(own, name, _only(row.line, name, getattr(own, name)))
        else:
            own.image, own.job = list(paths), []
        tasks.append(Task(number, row.name, paths, own, row.film))
    return tasks


def _row_options(
    row: ManifestRow, parser: RowParser, own: argparse.Namespace, folder: Path
) -> argparse.Namespace:
    """``own``, where the row says nothing else."""
    if row.values.keys() & {"camera", "focal_px"}:
        own.camera = own.focal_px = None  # one stands for the other
    arguments = []
    for name, values in row.values.items():
        if name not in parser.columns:
            kind, other = ("film", "photo") if row.film else ("photo", "film")
            raise RowError(row.line, f"'{name}' is of a {other}, and the row is a {kind}")
        setattr(own, name, parser.get_default(name))
        flag = parser.options[name].option_strings[0]
        arguments += [f"{flag}={value}" for value in values]
    try:
        own = parser.parse_args(arguments, own)
    except InputError as error:
        raise RowError(row.line, str(error).rstrip(".")) from error
    for name in row.values:
        setattr(own, name, _absolute(name, getattr(own, name), folder))
    return own


def _check_used(
    parsers: Sequence[RowParser], options: argparse.Namespace, kinds: set[bool]
) -> None:
    """Raises InputError for an option of the command line that no row would hear."""
    if len(kinds) > 1:
        return
    (film,) = kinds
    for name, action in parsers[not film].options.items():
        if name not in parsers[film].options and getattr(options, name) != action.default:
            kind, other = ("film", "photo") if film else ("photo", "film")
            raise InputError(
                f"{action.option_strings[0]} is of {other}s, and there are {kind}s alone; leave it "
                "out."
            )


def _only(line: int, name: str, values: Any) -> Any:
    """The one value of a film's option."""
    if not isinstance(values, list):
        return values
    if len(values) > 1:
        raise RowError(line, f"there are {len(values)} values of '{name}', of one film")
    return values[0]


def _absolute(name: str, value: Any, folder: Path) -> Any:
    """The value of an option with its path, if it is or has one, relative to ``folder`` no more:
    workers may be elsewhere.
    """
    if isinstance(value, list):
        return [_absolute(name, one, folder) for one in value]
    if isinstance(value, Path):
        return folder / value.expanduser()
    if name == "environment" and value is not None:
        return str(folder / value)
    if name == "model" and value is not None and ":" in value:
        kind, _, path = value.partition(":")
        return f"{kind}:{folder / Path(path).expanduser()}"
    return value
