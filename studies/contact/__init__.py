"""Shared by the contact studies: scenes, reference solutions and other friction laws."""
