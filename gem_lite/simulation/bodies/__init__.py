"""What lies on tables: shapes, objects, and what tasks build."""
