"""The engine's only room that knows Blender: armatures, actions, meshes, and Blender's own importers as readers."""
