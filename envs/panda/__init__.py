"""A Franka Panda arm: model, kinematics and control."""
