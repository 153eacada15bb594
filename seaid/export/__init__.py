"""What a user takes home: robot files that simulate like the machine."""
