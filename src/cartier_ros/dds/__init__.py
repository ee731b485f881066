"""ROS 2 topics over DDS, without ROS: message types from rosbags' type store, bytes in and out with cyclonedds."""
