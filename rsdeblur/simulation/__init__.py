"""Simulated photos: a forward model that shares no code with the blur paths and PSFs, a test scene and hand shake."""
