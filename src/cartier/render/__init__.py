"""Pictures of homes and answers: floor plan, contact sheet, Rerun file."""
