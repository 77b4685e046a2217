"""The simulated world: rigid bodies, tracks on the ground, ray casting and injected faults."""
