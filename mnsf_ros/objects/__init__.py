"""The online method: one motion for each object, on top of the sensor's own motion."""
