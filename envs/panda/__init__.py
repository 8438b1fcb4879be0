"""A Franka Panda arm: model, kinematics, control."""
