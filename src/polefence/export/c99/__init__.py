"""The C text of laws and observers, and the numbers in it."""
