"""Mapping over long ways: submaps, keyframes, loop closures and the graph that joins them."""
