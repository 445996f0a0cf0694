"""CBM as a Blender extension: `register()` and `unregister()`. The engine is `cbm_addon`, which also runs without Blender."""

from __future__ import annotations

registered: list[type] = []
cli_commands: list[object] = []


def classes() -> tuple[type, ...]:
    """Every Blender class of the extension, in the order in which they are registered."""
    from .operators.bake_take import CBM_OT_bake_take
    from .operators.calibrate_take import CBM_OT_calibrate_take
    from .operators.clear_body import CBM_OT_clear_body
    from .operators.import_mocap import CBM_OT_import_mocap
    from .operators.import_take import CBM_OT_import_take
    from .operators.load_model import CBM_OT_load_model
    from .operators.pose_fingers import CBM_OT_add_colliders, CBM_OT_pose_fingers, CBM_OT_show_hands
    from .operators.properties import CBM_PG_fingers, CBM_PG_settings
    from .operators.train_model import CBM_OT_train_model
    from .panels.sidebar import CBM_PT_sidebar

    return (
        CBM_PG_fingers,
        CBM_PG_settings,
        CBM_OT_import_mocap,
        CBM_OT_import_take,
        CBM_OT_calibrate_take,
        CBM_OT_load_model,
        CBM_OT_train_model,
        CBM_OT_bake_take,
        CBM_OT_pose_fingers,
        CBM_OT_clear_body,
        CBM_OT_add_colliders,
        CBM_OT_show_hands,
        CBM_PT_sidebar,
    )


def register() -> None:
    import bpy

    for cls in classes():
        bpy.utils.register_class(cls)
        registered.append(cls)
    settings = next(cls for cls in registered if cls.__name__ == "CBM_PG_settings")
    bpy.types.Scene.cbm = bpy.props.PointerProperty(type=settings)
    cli_commands.append(bpy.utils.register_cli_command("cbm", run_command))


def unregister() -> None:
    import bpy

    bpy.utils.unregister_cli_command(cli_commands.pop())
    del bpy.types.Scene.cbm
    while registered:
        bpy.utils.unregister_class(registered.pop())


def run_command(argv: list[str]) -> int:
    """`blender -b --command cbm COMMAND …`; returns the exit code."""
    from .cbm_addon.cli import main

    return main(argv)
