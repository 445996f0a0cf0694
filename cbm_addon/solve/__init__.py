"""From a calibrated take to motion: control, candidates, choice, fusion with inverse kinematics and foot locks. No torch, no bpy."""
