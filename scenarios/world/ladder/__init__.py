"""The contact ladder: one scene, five contact models of rising fidelity, one interface."""
