"""The byte faces of the plant: instruments that answer messages, without any input or output of their own."""
