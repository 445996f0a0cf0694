"""How thick the parts of a body are: what colliders are made of where no skin tells it."""

from __future__ import annotations

# Radii where a part begins and where it ends, and half of the distance between the two capsules that make a part wide; shares of the
# standing height of the head joint (1.6 m in an adult).
LIMBS = {"Arm": (0.034, 0.025, 0.0), "ForeArm": (0.027, 0.017, 0.0), "UpLeg": (0.057, 0.036, 0.0), "Leg": (0.037, 0.022, 0.0), "Foot": (0.024, 0.018, 0.008)}
NEXT = {"Arm": "ForeArm", "ForeArm": "Hand", "UpLeg": "Leg", "Leg": "Foot", "Foot": "Toe"}
TRUNK = (0.064, 0.064, 0.034)
NECK = (0.035, 0.034, 0.0)
HEAD = (0.058, 0.052, 0.0)
SKULL = 0.02, 0.075  # where its capsule begins and ends above the head joint
FOOT = 0.08  # length of a foot without toes
HAND = (0.022, 0.018, 0.010)
FIST = 0.06  # how far a hand reaches beyond its wrist, fingers apart
