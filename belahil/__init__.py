"""The words everybody shares: values, stimuli, interfaces, files, the bench and the run."""
