"""When to render: rules of sampling in time, and what lies between two renders."""
