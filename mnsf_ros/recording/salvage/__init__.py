"""Reading recordings that are damaged, cut short or without an index, as far as they are there."""
