"""Rigid transforms, poses in messages and along a recording, and the flow of rigid motions."""
