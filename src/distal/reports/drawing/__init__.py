"""The components of a rig in a drawing: drives, tendons, joints and sensors."""
