"""All pictures and charts: shared by the report, the studies, the demo and the documentation."""
