"""Our guidance bands and alerts beside those of NASA's DAIDALUS, on DAIDALUS's own scenarios."""
