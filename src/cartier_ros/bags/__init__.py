"""ROS 1 and ROS 2 bags: storage formats, topics, images, transforms."""
