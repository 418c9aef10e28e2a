"""The parts of the mallet tap: the blow, who delivers it, and how it is judged."""
