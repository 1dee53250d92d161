"""What everything meets at: arrays of events, packets of them, and the luma that they are made of."""
