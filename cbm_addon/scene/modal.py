"""Long jobs in Blender: synchronous in background, modal with progress and Esc in a window. Both drive the same generator."""

from __future__ import annotations

import time
from typing import Any

import bpy

from ..errors import InputError
from ..progress import Job, run

SLICE = 0.1  # seconds of work between looks at the window


class ModalJob:
    """Mix-in for operators: they define `job(context)`, which gives a generator of progress, and `finish(context, result)`.

    A job that is closed before its end leaves the scene as it was: that is the job's own duty.
    """

    _job: Job[Any] | None = None
    _timer: bpy.types.Timer | None = None

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
        self._job = job
        manager = context.window_manager
        self._timer = manager.event_timer_add(0.02, window=context.window)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "ESC":
            self._leave(context)
            self.report({"WARNING"}, f"{self.bl_label} was cancelled; nothing was changed")
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        try:
            self._work(context)
        except StopIteration as end:
            self._leave(context)
            self.finish(context, end.value)
            return {"FINISHED"}
        except InputError as error:
            self._leave(context)
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender closes or loads another file."""
        self._leave(context)

    def _work(self, context: bpy.types.Context) -> None:
        """A slice of the job; StopIteration at its end."""
        assert self._job is not None
        until = time.monotonic() + SLICE
        while time.monotonic() < until:
            progress = next(self._job)
            settings = context.scene.cbm
            settings.progress, settings.doing = progress.share, progress.message
        for area in context.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()

    def _leave(self, context: bpy.types.Context) -> None:
        if self._job is not None:
            self._job.close()
            self._job = None
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None
        context.scene.cbm.doing = ""
