"""What robots share: the latest transforms."""
