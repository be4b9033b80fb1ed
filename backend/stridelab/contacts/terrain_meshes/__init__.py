"""Terrains from meshes: reads a mesh, and finds the surfaces on which feet can stand."""
