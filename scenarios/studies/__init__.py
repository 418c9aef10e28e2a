"""Why: studies of physics, signal, reaction, detectors, Table IV. No run needs them."""
