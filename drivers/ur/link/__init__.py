"""Link of the arm driver to the wire: ur_rtde in a supervised process."""
