"""The physics of a scene: contact laws, fingertips, objects; ``cell`` joins it to the devices."""
