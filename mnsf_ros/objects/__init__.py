"""The online method: ego motion, plus one motion per object."""
