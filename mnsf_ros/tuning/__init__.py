"""The best settings of the method online for recordings of one's own."""
