"""The parts of the reader of Gazebo worlds: XML, poses, frames, states, models, shapes, meshes."""
