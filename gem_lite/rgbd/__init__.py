"""RGB-D cameras and what is made of their pictures. Nothing here knows a simulator."""
