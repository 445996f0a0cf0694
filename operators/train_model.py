"""Train a model in another Python, which has torch, and show its progress here."""

from __future__ import annotations

import json
import os
import queue
import shutil
import subprocess
import tempfile
import threading
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import IO

import bpy

from ..cbm_addon.errors import InputError
from ..cbm_addon.progress import Progress
from ..cbm_addon.scene.modal import ModalJob


def training(python: str, arguments: list[str]) -> Generator[Progress, None, str]:
    """Runs `python -m cbm_addon train …` and yields its progress, which it prints as JSON lines; returns its last words.

    It also yields while the training says nothing, so that the window stays awake. Closing the generator ends the training; its checkpoints
    stay. InputError with the trainer's own line if it fails.
    """
    engine = Path(__file__).parent.parent
    command = [python, "-m", "cbm_addon", "train", *arguments, "--json-lines"]
    said, progress = "", Progress(0, "starting the training")
    with tempfile.TemporaryFile("w+") as errors:
        process = subprocess.Popen(command, cwd=engine, env={**os.environ, "PYTHONUNBUFFERED": "1"}, stdout=subprocess.PIPE, stderr=errors, text=True)
        assert process.stdout is not None
        try:
            for line in lines_or_silence(process.stdout):
                event = json.loads(line or "{}")
                said = event.get("said", said)
                if "share" in event:
                    progress = Progress(event["share"], event["message"])
                yield progress
            if process.wait():
                errors.seek(0)
                last = (errors.read().strip().splitlines() or [f"exit code {process.returncode}"])[-1]
                raise InputError("training", last.removeprefix("error: "))
        finally:
            if process.poll() is None:
                process.terminate()
                process.wait()
    return said


def lines_or_silence(stream: IO[str]) -> Iterator[str]:
    """The lines of a pipe as they come, and an empty text whenever none came within a tenth of a second. Closes the pipe at its end."""
    lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()

    def read() -> None:
        with stream:
            for line in stream:
                lines.put(line)
        lines.put(None)

    threading.Thread(target=read, daemon=True).start()
    while True:
        try:
            line = lines.get(timeout=0.1)
        except queue.Empty:
            yield ""
            continue
        if line is None:
            return
        yield line


class CBM_OT_train_model(bpy.types.Operator, ModalJob):
    bl_idname = "cbm.train_model"
    bl_label = "Train Model"
    bl_description = "Train a model on BVH clips in a Python that has torch and onnx, with progress here; Esc stops it, and Resume continues"

    data: bpy.props.StringProperty(name="Clips", description="A BVH file or a folder of them, with the engine's joint names", subtype="FILE_PATH")
    output: bpy.props.StringProperty(name="Model Folder", description="The folder to write", subtype="DIR_PATH")
    python: bpy.props.StringProperty(name="Python", description="A Python interpreter that has torch and onnx", default="python3", subtype="FILE_PATH")
    config: bpy.props.StringProperty(name="Configuration", description="A TOML file with sizes, losses and schedule", subtype="FILE_PATH")
    resume: bpy.props.BoolProperty(name="Resume", description="Continue from the folder's checkpoints")

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return context.window_manager.invoke_props_dialog(self, width=500)

    def job(self, context: bpy.types.Context) -> Generator[Progress, None, str]:
        """The training; InputError before it begins if an option is missing."""
        python = shutil.which(bpy.path.abspath(self.python)) or shutil.which(self.python)
        if python is None:
            raise InputError(self.python, "is not an interpreter; name a Python that has torch and onnx")
        for name in ("data", "output"):
            if not getattr(self, name):
                raise InputError(name, "is not given; training needs clips and a folder to write")
        arguments = [bpy.path.abspath(self.data), "-o", bpy.path.abspath(self.output)]
        arguments += ["--config", bpy.path.abspath(self.config)] if self.config else []
        arguments += ["--resume"] if self.resume else []
        return training(python, arguments)

    def finish(self, context: bpy.types.Context, result: str) -> None:
        self.report({"INFO"}, result)
