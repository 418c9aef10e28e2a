"""Research questions, one file each. They are not part of the installed application."""
