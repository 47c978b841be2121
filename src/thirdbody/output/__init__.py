"""What a run leaves behind: the trajectory file, its reader, its pictures and what opens it in ParaView."""
