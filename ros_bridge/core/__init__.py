"""What messages mean, without ROS: fields, frames, tracks, the situation and the monitor."""
