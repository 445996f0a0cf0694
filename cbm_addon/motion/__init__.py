"""What motion is: rotations, skeletons, forward kinematics, resampling, mirroring, the root frame, contacts and BVH files."""
