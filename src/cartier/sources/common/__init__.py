"""What several live sources share: pairing, transforms, pacing."""
