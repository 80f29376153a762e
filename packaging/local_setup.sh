# Lets ROS 2 and `modulo` find what is installed here; to be sourced.
_modulo_prefix="${COLCON_CURRENT_PREFIX:-${AMENT_CURRENT_PREFIX:-/usr}}"
case ":${AMENT_PREFIX_PATH}:" in
  *":${_modulo_prefix}:"*) ;;
  *) export AMENT_PREFIX_PATH="${_modulo_prefix}${AMENT_PREFIX_PATH:+:${AMENT_PREFIX_PATH}}" ;;
esac
unset _modulo_prefix
