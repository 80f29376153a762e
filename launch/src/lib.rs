//! ROS 2 YAML launch files: parser, plan and process supervisor.
