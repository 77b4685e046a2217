"""SLAM over long ways: scan matching to submaps, loop closures, and a graph of keyframe poses."""
