"""What a recording is: a take, one reader per format, calibration, takes made from mocap, and the shipped sample."""
