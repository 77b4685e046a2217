"""SLAM over long distances: scans matched to submaps, loop closures, a graph of keyframes."""
