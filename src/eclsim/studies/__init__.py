"""Studies: the questions asked of one model or of many, each a function with labelled results."""
