"""What travels: packets as bytes and as values (`protocol`), and ways to carry them."""
