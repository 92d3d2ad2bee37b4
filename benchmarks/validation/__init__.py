"""granpipe against what others have measured, published or programmed: cases with criteria stated before the run."""
