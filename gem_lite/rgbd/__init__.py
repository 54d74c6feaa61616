"""RGB-D cameras, views and height maps. Nothing here needs a simulator."""
