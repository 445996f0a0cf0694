"""Hands that touch without piercing: the hand's angles and limits, what it must not enter, the sensor, the networks, the solver."""
