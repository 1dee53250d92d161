"""What accuracy costs in time: the sweep, its settings, its report."""
