"""Long jobs in Blender: synchronous in background, modal with progress and Esc in a window. Both drive the same generator."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import bpy

from ..errors import InputError
from ..progress import Job, Progress, run

SLICE = 0.1  # seconds of work between looks at the window


@dataclass
class Running:
    """The job that runs in a window."""

    job: Job[Any]
    timer: bpy.types.Timer
    progress: Progress


class ModalJob:
    """Mix-in for operators: they define `job(context)`, which gives a generator of progress, and `finish(context, result)`.

    A job that is closed before its end leaves the scene as it was: that is the job's own duty. Such an operator must not have the option
    REGISTER: Blender's Adjust Last Operation panel would call it again after an undo, and crashes when that call becomes modal.
    """

    bl_label: str
    report: Callable[[set[str], str], None]
    job: Callable[[bpy.types.Context], Job[Any]]
    finish: Callable[[bpy.types.Context, Any], None]

    running: ClassVar[Running | None] = None
    """One job at a time. It is no property of the scene, because those are saved and undone with the file."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return ModalJob.running is None

    @classmethod
    def unregister(cls) -> None:
        """Blender drops a running operator without a word when its class goes."""
        stop()

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Everything at once in background; in a window the job goes on while the window lives."""
        try:
            job = self.job(context)
            if bpy.app.background or context.window is None:
                self.finish(context, run(job))
                return {"FINISHED"}
        except InputError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        timer = context.window_manager.event_timer_add(0.02, window=context.window)
        ModalJob.running = Running(job, timer, Progress(0, self.bl_label))
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "ESC" and event.value == "PRESS":
            stop()
            self.report({"WARNING"}, f"{self.bl_label} was cancelled; the scene is unchanged")
            return {"CANCELLED"}
        if event.type == "TIMER":
            try:
                work()
            except StopIteration as end:
                stop()
                self.finish(context, end.value)
                return {"FINISHED"}
            except Exception as error:
                stop()
                if not isinstance(error, (InputError, ReferenceError)):
                    raise
                gone = f"{self.bl_label} stopped: what it worked on was removed or undone"
                self.report({"ERROR"}, gone if isinstance(error, ReferenceError) else str(error))
                return {"CANCELLED"}
        return {"PASS_THROUGH"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender closes or loads another file."""
        stop()


def work() -> None:
    """A slice of the job that runs; StopIteration at its end."""
    running = ModalJob.running
    assert running is not None
    until = time.monotonic() + SLICE
    while time.monotonic() < until:
        running.progress = next(running.job)
    redraw()


def stop() -> None:
    """Closes the job that runs, if one does."""
    running, ModalJob.running = ModalJob.running, None
    if running is not None:
        running.job.close()
        bpy.context.window_manager.event_timer_remove(running.timer)
        redraw()


def redraw() -> None:
    """Shows the progress in the sidebars of all windows."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()
