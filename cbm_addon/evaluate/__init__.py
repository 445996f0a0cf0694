"""How good the answers are: metrics against motion capture, baselines, the score card."""
