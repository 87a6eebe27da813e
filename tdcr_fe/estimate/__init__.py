"""Shape, tensions and external force of a robot, frame by frame, with their covariance."""
