"""A room of belahil: the words that all rooms share (values, stimuli, interfaces, files, bench, run)."""
