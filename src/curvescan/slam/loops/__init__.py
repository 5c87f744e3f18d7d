"""Loop closures: where keyframes look alike, which matches agree, their odds, and what contradicts a finished map."""
