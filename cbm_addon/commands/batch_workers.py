"""The processes of a batch. Blender does one thing at a time, and starting it takes seconds: a few processes each bake take after take.

The batch writes one JSON line a task to a worker's stdin; the worker answers with JSON lines: its progress, and then a result.
"""

from __future__ import annotations

import json
import os
import queue
import subprocess
import sys
import tempfile
import threading
import traceback
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import IO, Any

from ..console import Console
from ..errors import InputError
from ..outputs import remove_temporaries
from ..progress import Job, Progress
from .bake import bake_file
from .batch_job import BakeParser, Task

SILENCE = 0.1  # seconds without a word after which progress is told again
ENGINE = Path(__file__).parents[1]


@dataclass(frozen=True)
class Outcome:
    """What became of a task: its report, or why it failed, with the traceback if that was a fault of ours."""

    task: Task
    report: dict[str, Any] | None = None
    error: str | None = None
    traceback: str | None = None


class Worker:
    """A process that bakes; what it says arrives in `events`, and None when it ends."""

    def __init__(self, folder: Path, threads: int, events: queue.SimpleQueue[tuple[Worker, dict[str, Any] | None]]) -> None:
        self.task: Task | None = None
        self.share = 0.0
        self._log = Path(folder, f"worker{id(self)}.log")
        places = {name: str(folder) for name in ("TMPDIR", "TEMP", "TMP")}  # whatever a worker leaves behind goes with this folder
        with self._log.open("w") as log:
            self.process = subprocess.Popen(
                worker_command(folder, threads),
                env={**os.environ, **places, "PYTHONPATH": os.pathsep.join(_import_paths()), "PYTHONUNBUFFERED": "1"},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
                encoding="utf-8",
            )
        threading.Thread(target=self._listen, args=[events], daemon=True).start()

    def _listen(self, events: queue.SimpleQueue[tuple[Worker, dict[str, Any] | None]]) -> None:
        assert self.process.stdout is not None
        for said in _json_lines(self.process.stdout):
            events.put((self, said))
        events.put((self, None))

    def begin(self, task: Task, overwrite: bool) -> None:
        self.task, self.share = task, 0.0
        for output in task.outputs:
            output.parent.mkdir(parents=True, exist_ok=True)
        assert self.process.stdin is not None
        with suppress(OSError):  # if it has ended, its last event will say so
            print(json.dumps([*task.argv, *(["--overwrite"] if overwrite else [])]), file=self.process.stdin, flush=True)

    def last_words(self) -> str:
        lines = self._log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        return lines[-1] if lines else "it said nothing"

    def end(self) -> None:
        """Ends the process at once and removes what it was writing."""
        self.process.kill()
        self.process.wait()
        assert self.process.stdin is not None
        self.process.stdin.close()
        if self.task:
            remove_temporaries(self.task.outputs, self.process.pid)


def _import_paths() -> list[str]:
    """Where a new Python finds the engine and the onnxruntime that Blender may have unpacked for the extension. Not all of sys.path: what the
    bpy module has put there hides the module itself."""
    onnxruntime = find_spec("onnxruntime")
    libraries = [str(Path(onnxruntime.origin).parents[1])] if onnxruntime and onnxruntime.origin else []
    return [str(ENGINE.parent), *libraries]


def worker_command(folder: Path, threads: int) -> list[str]:
    """The command of a worker: inside Blender another Blender with the same extension, else another of this Python."""
    command = ["batch", f"--worker={folder}", f"--threads={threads}"]
    blender = getattr(getattr(sys.modules.get("bpy"), "app", None), "binary_path", "")
    if not blender:
        return [sys.executable, "-m", ENGINE.name, *command]
    extension = (__package__ or "").removesuffix(f".{ENGINE.name}.commands")
    return [blender, "--background", "--addons", extension, "--command", "cbm", *command]


def working(tasks: list[Task], workers: int, overwrite: bool) -> Job[list[Outcome]]:
    """Does tasks in that many processes. A task that fails, or takes its process with it, does not stop the others.

    Closing the job ends the processes; what they were writing is removed.
    """
    waiting, outcomes = deque(tasks), list[Outcome]()
    events: queue.SimpleQueue[tuple[Worker, dict[str, Any] | None]] = queue.SimpleQueue()
    count = min(workers, len(tasks))
    threads = max(1, (os.cpu_count() or 1) // max(1, count))
    crew: list[Worker] = []
    message = "starting"
    with tempfile.TemporaryDirectory(prefix="cbm-batch-", ignore_cleanup_errors=True) as folder:
        try:
            while len(outcomes) < len(tasks):
                while waiting and len(crew) < count:
                    crew.append(Worker(Path(folder), threads, events))
                    crew[-1].begin(waiting.popleft(), overwrite)
                try:
                    worker, said = events.get(timeout=SILENCE)
                except queue.Empty:
                    said, worker = {}, crew[0]
                if outcome := _outcome(worker, said):
                    outcomes.append(outcome)
                    message = f"{outcome.task.name}: {'failed' if outcome.error else 'done'}"
                    worker.task = None
                    if said is None:
                        worker.end()
                        crew.remove(worker)
                    elif waiting:
                        worker.begin(waiting.popleft(), overwrite)
                elif said is None:  # it was idle
                    crew.remove(worker)
                elif "share" in said:
                    worker.share = said["share"]
                share = (len(outcomes) + sum(worker.share for worker in crew if worker.task)) / len(tasks)
                yield Progress(share, f"{len(outcomes)} of {len(tasks)}, {message}")
        finally:
            for worker in crew:
                worker.end()
    order = {task.name: place for place, task in enumerate(tasks)}
    return sorted(outcomes, key=lambda outcome: order[outcome.task.name])


def _outcome(worker: Worker, said: dict[str, Any] | None) -> Outcome | None:
    """What became of a worker's task, if that is what it said."""
    if worker.task is None:
        return None
    if said is None:
        remove_temporaries(worker.task.outputs, worker.process.pid)
        return Outcome(worker.task, error=f"its process ended with code {worker.process.wait()}: {worker.last_words()}")
    if "error" in said:
        return Outcome(worker.task, error=said["error"], traceback=said.get("traceback"))
    return Outcome(worker.task, report=said["report"]) if "report" in said else None


def _json_lines(stream: IO[str]) -> Iterator[dict[str, Any]]:
    """The JSON objects among the lines of a stream; Blender has words of its own."""
    for line in stream:
        try:
            value = json.loads(line)
        except ValueError:
            continue
        if isinstance(value, dict):
            yield value


# In a worker


def work(folder: Path, threads: int, plain: Any) -> None:
    """Bakes what stdin asks for, a JSON list of arguments a line, until it ends. `plain` makes a report JSON.

    folder  a temporary one, where new files of presets are kept for the next task
    """
    from ..solve.models import load_model

    @cache
    def model(path: Path | None) -> Any:
        return load_model(path, threads)

    for line in sys.stdin:
        try:
            args = BakeParser().parse_args(json.loads(line))
            answer = {"report": plain(bake_file(args, Console(json_lines=True), model, folder))}
        except InputError as error:
            answer = {"error": str(error)}
        except Exception as error:
            answer = {"error": f"a fault of ours: {type(error).__name__}: {error}", "traceback": traceback.format_exc()}
        print(json.dumps(answer), flush=True)
