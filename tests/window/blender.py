"""A Blender with its window on a screen of its own, as the tests see, ask and click it."""

from __future__ import annotations

import csv
import io
import json
import os
import re
import shlex
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from difflib import SequenceMatcher
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
WIDTH, HEIGHT = 1600, 1000
ANSWER_SECONDS = 120.0
Box = tuple[int, int, int, int]  # left, top, width, height
Word = tuple[str, int, int]
TABS = 26
LENIENT = 2.0  # a busy machine's processor does less in the same time
LAYOUTS = (6, 11, 6)  # the screen may have moved
SIDEBAR = """
area = bpy.context.area
region = next(each for each in area.regions if each.type == "UI")
answer = region.x, region.y, region.width, region.height
"""
ENLARGED = 4  # for reading: a letter of Blender's is eight pixels high


@dataclass
class Blender:
    """One Blender. Wants root, Debian's Blender in ``root``, and the ``project``'s environment.

    ``out`` is where screenshots, settings and the log go. Inside Blender all paths are as outside.
    """

    root: Path
    project: Path
    out: Path
    display: str
    process: subprocess.Popen[bytes] | None = None
    asked: int = 0
    shots: int = 0
    longest: dict[str, float] = field(default_factory=dict)  # milliseconds

    def start(self, *arguments: str) -> None:
        """Start Blender with its default scene and wait until it answers."""
        self.talk.mkdir(parents=True, exist_ok=True)
        for old in self.talk.iterdir():
            old.unlink()
        geometry = ["--window-geometry", "0", "0", str(WIDTH), str(HEIGHT)]
        script = ["--python", str(HERE / "inside.py")]
        with (self.out / "blender.log").open("ab") as log:
            self.process = subprocess.Popen(
                self.command([*geometry, *arguments, *script]),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=self.environment(),
            )
        self.do("pass")

    def stop(self) -> None:
        """End Blender, however it is."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self.process = None

    def console(self, arguments: Sequence[str]) -> str:
        """Run Blender without its window, and return what it says."""
        done = subprocess.run(
            self.command(arguments),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding="utf-8",
            errors="replace",
            env=self.environment(),
        )
        assert done.returncode == 0, done.stdout
        return done.stdout

    @property
    def talk(self) -> Path:
        """The folder of questions and answers."""
        return self.out / "talk"

    @property
    def backend(self) -> Path:
        """A command that runs the project's backend from inside Blender's Debian."""
        return self.out / "facestage"

    def command(self, arguments: Sequence[str]) -> list[str]:
        """Blender in its own Debian, which sees the project, the output and the machine itself."""
        self.backend.write_text(
            "#!/bin/sh\n"
            f'exec chroot /host {shlex.quote(str(self.project / ".venv/bin/facestage"))} "$@"\n'
        )
        self.backend.chmod(0o755)
        root, steps = shlex.quote(str(self.root)), []
        seen = {Path("/tmp"), self.project, self.out, HERE}
        places = [("/proc", "/proc"), ("/dev", "/dev"), ("/", "/host")]
        places += [(str(path), str(path)) for path in sorted(seen)]
        for source, target in places:
            place = f"{root}{shlex.quote(target)}"
            steps.append(f"mkdir -p {place}")
            steps.append(f"mount --rbind {shlex.quote(source)} {place}")
        steps.append(f'exec chroot {root} /usr/bin/blender "$@"')
        return ["unshare", "--mount", "sh", "-e", "-c", "\n".join(steps), "sh", *arguments]

    def environment(self) -> dict[str, str]:
        """A user of Blender's own, without what this machine's user has set."""
        return {
            "PATH": "/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin",
            "HOME": os.environ.get("HOME", "/root"),
            "LANG": "C.UTF-8",
            "DISPLAY": self.display,
            "LIBGL_ALWAYS_SOFTWARE": "1",
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
            "BLENDER_USER_RESOURCES": str(self.out / "user"),
            "FACESTAGE_TALK": str(self.talk),
        }

    def do(self, code: str, seconds: float = ANSWER_SECONDS) -> Any:
        """Run Python inside Blender's window; returns what it leaves in ``answer``."""
        self.asked += 1
        name = f"{self.asked:05d}"
        partial = self.talk / f"{name}.partial"
        partial.write_text(code, encoding="utf-8")
        partial.rename(self.talk / f"{name}.py")
        answered = self.talk / f"{name}.json"
        self.wait(answered.exists, seconds, f"an answer to: {code}")
        answer = json.loads(answered.read_text(encoding="utf-8"))
        answered.unlink()
        assert "error" not in answer, f"{code}\n{answer['error']}"
        return answer["answer"]

    def ask(self, expression: str) -> Any:
        """The value of a Python expression inside Blender."""
        return self.do(f"answer = {expression}")

    def wait(self, happened: Callable[[], object], seconds: float, what: str) -> None:
        """Wait until ``happened``, or fail with ``what`` did not."""
        end = time.monotonic() + seconds
        while not happened():
            gone = self.process is not None and self.process.poll() is not None
            if gone or time.monotonic() > end:
                self.shot("failed")
                why = "Blender ended" if gone else f"{seconds:.0f} s passed"
                raise AssertionError(f"{why} without {what}; see {self.out / 'blender.log'}")
            time.sleep(0.05)

    def until(self, expression: str, seconds: float = 60.0) -> None:
        """Wait until a Python expression inside Blender is true."""
        self.wait(lambda: self.ask(expression), seconds, expression)

    def idle(self, seconds: float = 300.0) -> None:
        """Wait until no task of the backend runs."""
        self.until("not bpy.context.window_manager.facestage.task", seconds)

    def settle(self) -> None:
        """Have drawn what has changed: without a graphics card a drawing takes seconds."""
        if self.process is None or self.process.poll() is None:
            self.do("bpy.ops.wm.redraw_timer(type='DRAW_WIN_SWAP', iterations=1)")

    @contextmanager
    def stalls(self, what: str, limit: float) -> Iterator[None]:
        """Note in stalls.json the longest time in which the window answers nothing while ``what``
        is done: milliseconds of its thread's processor time, drawing with them.

        Fails where that is more than LENIENT times the ``limit`` that people are promised.
        """
        self.do("beat['longest'] = 0.0")
        yield
        self.longest[what] = round(1000.0 * self.ask("beat['longest']"), 1)
        path = self.out / "stalls.json"
        path.write_text(json.dumps(self.longest, indent=1), encoding="utf-8")
        assert self.longest[what] <= LENIENT * limit, f"{what} holds the window; see {path}"

    def shot(self, name: str) -> Path:
        """A picture of the whole screen, numbered in the order of the walk."""
        self.settle()
        path = self.out / f"{self.shots:02d}-{name}.png"
        self.shots += 1
        self._run("import", "-window", "root", str(path))
        return path

    def sidebar(self) -> Box:
        """Where the 3D View's sidebar is on the screen, without its tabs."""
        x, y, width, height = self.do(SIDEBAR)
        return x, HEIGHT - y - height, width - TABS, height

    def read(self, box: Box | None = None, layout: int = 6) -> list[Word]:
        """The words in a part of the screen (of all of it: seconds), with their middles.

        ``layout``: how tesseract looks for them; 6 as one column of lines, 11 anywhere.
        """
        self.settle()
        left, top, width, height = box or (0, 0, WIDTH, HEIGHT)
        picture = self.out / "reading.png"
        part = ["-crop", f"{width}x{height}+{left}+{top}", "+repage"]
        grow = ["-colorspace", "Gray", "-resize", f"{100 * ENLARGED}%", "-negate"]
        self._run("import", "-window", "root", *part, *grow, str(picture))
        table = self._run("tesseract", str(picture), "-", "--psm", str(layout), "tsv")
        words = []
        for row in csv.DictReader(io.StringIO(table), delimiter="\t", quoting=csv.QUOTE_NONE):
            if row["text"] and row["text"].strip():
                x, y, w, h = (int(row[side]) for side in ("left", "top", "width", "height"))
                middle = left + (x + w // 2) // ENLARGED, top + (y + h // 2) // ENLARGED
                words.append((row["text"].strip(), *middle))
        return words

    def find(self, text: str, box: Box | None = None) -> tuple[int, int]:
        """Where ``text`` stands in the sidebar or in ``box``: the middle of its words.

        Fails where it does not, or is cut off.
        """
        wanted = [_letters(word) for word in text.split()]
        for layout in LAYOUTS:
            words = self.read(box or self.sidebar(), layout)
            for start in range(len(words) - len(wanted) + 1):
                run = words[start : start + len(wanted)]
                if _alike([_letters(word) for word, _, _ in run], wanted) and _in_line(run):
                    return sum(x for _, x, _ in run) // len(run), run[0][2]
        self.shot("not-found")
        seen = " ".join(word for word, _, _ in words)
        raise AssertionError(f"'{text}' is not on the screen, which shows: {seen}")

    def click(self, text: str, box: Box | None = None) -> None:
        """Press what is labelled ``text`` in the sidebar or in ``box``, as a hand would."""
        self.press(*self.find(text, box))

    def open_tab(self) -> None:
        """Show Facestage's tab of the sidebar, without a click: it may not be drawn yet."""
        self.settle()
        self.do(
            "sidebar = next(each for each in bpy.context.area.regions if each.type == 'UI')\n"
            "sidebar.active_panel_category = 'Facestage'\n"
        )
        self.settle()

    def press(self, x: int, y: int, button: int = 1) -> None:
        """Press a mouse button at a place of the screen."""
        self._run("xdotool", "mousemove", str(x), str(y))
        time.sleep(0.4)
        self._run("xdotool", "click", str(button))
        time.sleep(0.4)

    def drag(self, *places: tuple[int, int], let_go: bool = True) -> None:
        """Pull the left mouse button from the first place of the screen to the last."""
        self.move(*places[0])
        self._run("xdotool", "mousedown", "1")
        for x, y in places[1:]:
            time.sleep(0.2)
            self._run("xdotool", "mousemove", str(x), str(y))
        time.sleep(0.4)
        if let_go:
            self.let_go()

    def let_go(self) -> None:
        """Release the left mouse button."""
        self._run("xdotool", "mouseup", "1")
        time.sleep(0.4)

    def key(self, *keys: str) -> None:
        """Press keys, by the names of X."""
        self._run("xdotool", "key", *keys)
        time.sleep(0.3)

    def type(self, text: str) -> None:
        """Type letters."""
        self._run("xdotool", "type", "--delay", "30", text)
        time.sleep(0.3)

    def scroll(self, notches: int) -> None:
        """Turn the mouse's wheel over the sidebar, down where positive."""
        left, top, width, height = self.sidebar()
        self.move(left + width // 2, top + height // 2)
        for _ in range(abs(notches)):
            self._run("xdotool", "click", "5" if notches > 0 else "4")
        time.sleep(0.3)

    def move(self, x: int, y: int) -> None:
        """Move the mouse."""
        self._run("xdotool", "mousemove", str(x), str(y))
        time.sleep(0.2)

    def _run(self, *command: str) -> str:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            env={**os.environ, "DISPLAY": self.display, "OMP_THREAD_LIMIT": "1"},
        )
        assert done.returncode == 0, f"{shlex.join(command)}: {done.stderr}"
        return done.stdout


def missing(root: Path) -> str:
    """Why no Blender can be started here; empty where one can."""
    if os.name != "posix" or os.geteuid() != 0:
        return "only root can change into Blender's Debian"
    tools = ("Xvfb", "xdotool", "import", "convert", "tesseract", "unshare")
    absent = [tool for tool in tools if shutil.which(tool) is None]
    if absent:
        return f"needs {', '.join(absent)} (make test-window installs them)"
    if not (root / "usr/bin/blender").exists():
        return f"needs Blender in {root} (make test-window installs it)"
    return ""


@contextmanager
def screen() -> Iterator[str]:
    """A screen of its own; its name."""
    read, write = os.pipe()
    size = f"{WIDTH}x{HEIGHT}x24"
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(write), "-screen", "0", size, "-nolisten", "tcp"],
        pass_fds=(write,),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.close(write)
    try:
        with os.fdopen(read) as said:
            number = said.readline().strip()
        assert number, "Xvfb did not start"
        yield f":{number}"
    finally:
        server.terminate()
        server.wait()


def _letters(word: str) -> str:
    return re.sub(r"[^a-z0-9]", "", word.lower())


def _alike(seen: list[str], wanted: list[str]) -> bool:
    """Whether words were meant, some letters misread; the last one, which is cut off first, too."""
    whole = SequenceMatcher(None, "".join(seen), "".join(wanted)).ratio()
    return whole > 0.85 and SequenceMatcher(None, seen[-1], wanted[-1]).ratio() > 0.7


def _in_line(run: list[Word]) -> bool:
    return max(y for _, _, y in run) - min(y for _, _, y in run) < 8
