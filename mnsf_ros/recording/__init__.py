"""Reading and writing recordings (bags), with or without the true flow."""
