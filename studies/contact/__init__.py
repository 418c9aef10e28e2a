"""What the studies of contact models share: stated scenes, and other ways to solve them."""
