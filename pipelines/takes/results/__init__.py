"""Results of stages: records, figures, bakes and videos; what is damaged."""
