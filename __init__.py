"""CBM as a Blender extension: `register()` and `unregister()`. The engine is `cbm_addon`, which also runs without Blender."""

from __future__ import annotations

registered: list[type] = []
cli_commands: list[object] = []


def classes() -> tuple[type, ...]:
    """Every Blender class of the extension, in the order in which they are registered."""
    from .operators.import_mocap import CBM_OT_import_mocap

    return (CBM_OT_import_mocap,)


def register() -> None:
    import bpy

    for cls in classes():
        bpy.utils.register_class(cls)
        registered.append(cls)
    cli_commands.append(bpy.utils.register_cli_command("cbm", run_command))


def unregister() -> None:
    import bpy

    while cli_commands:
        bpy.utils.unregister_cli_command(cli_commands.pop())
    while registered:
        bpy.utils.unregister_class(registered.pop())


def run_command(argv: list[str]) -> int:
    """`blender -b --command cbm COMMAND …`; returns the exit code."""
    from .cbm_addon.cli import main

    return main(argv)
