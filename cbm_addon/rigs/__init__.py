"""What a target is, without Blender: a rig's bones and their roles, its own proportions as a body, and motion as poses of its bones."""
