"""Poses that change: drift that depth shows and mends, jumps, and where one map lies in the world of another."""
