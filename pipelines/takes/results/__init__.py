"""What stages make: records, figures, bakes and videos; what is damaged."""
