"""Readers of the data sets that papers use: Replica, ScanNet, 7-Scenes."""
