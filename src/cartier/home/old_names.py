"""Names of fields in homes that cartier 0.1.0 wrote, and what they are called today."""

OLD_OBJECTS = {"sightings": "n_detected", "chances": "n_observable"}
"""In ``objects.json``."""

OLD_GROWTH = OLD_OBJECTS | {
    "low": "box_min", "high": "box_max", "reach_low": "extent_min", "reach_high": "extent_max",
    "tried": "observable", "hits": "detected",
    "label": "label_votes", "weight": "label_weights", "odds": "distance_odds", "extent": "size_at_1m",
    "together": "covisible",
}  # fmt: skip
"""In ``growth/object_map.npz`` and ``.json``."""
