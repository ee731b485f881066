"""Goal poses and paths on the occupancy grid."""
