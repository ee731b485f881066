"""Messages of ROS as a stream of frames: from the network, or from a bag."""
