"""The open take: its runs, settings, exports and shares."""
