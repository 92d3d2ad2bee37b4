"""From a measured angle of repose to the friction of contacts: heaps of real LIGGGHTS runs, fitted and inverted."""
