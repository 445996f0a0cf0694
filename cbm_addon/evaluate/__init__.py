"""How good the answers are: metrics against motion capture, baselines, the score card."""

METHODS = ("ours", "legs-carried", "motion-matching", "shuffled-codes")
