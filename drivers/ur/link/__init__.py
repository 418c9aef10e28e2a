"""From the arm driver to the wire: ur_rtde in a process of its own, supervised."""
