"""What to render: scenes, what they are made of, and those that are built in."""
