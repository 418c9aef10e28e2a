"""Physics of a scene: contact laws, fingertips, objects. ``cell`` joins them to the devices."""
