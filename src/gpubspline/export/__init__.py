"""Writing models: one file per format."""
