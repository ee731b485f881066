"""ROS 2 and ROS 1: bags, live topics over DDS, robots that drive by Nav2, and a simulated robot on topics."""
