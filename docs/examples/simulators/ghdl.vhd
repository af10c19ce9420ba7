-- A VHDL board as a simulator for haptogram (docs/simulators.md), by GHDL. The names of the board
-- and of its ports stand in the line of `firmware`; one that answers has a tx as well.
--   ghdl -a --std=08 board.vhd ghdl.vhd && ghdl -e --std=08 simulator
--   ghdl -r --std=08 simulator -gHALF_CLOCK_PS=15625 -gPERIOD_NS=25000 -gSTART_NS=0 -gCOUNT=16
-- START_NS: from power-up until it takes bytes.
library ieee; use ieee.std_logic_1164.all, std.textio.all;
entity simulator is
    generic (HALF_CLOCK_PS, PERIOD_NS, COUNT : positive := 1; START_NS : natural := 0);
end entity;
architecture lines of simulator is
    signal clk : std_logic := '0';
    signal rx, tx : std_logic := '1';
    signal pins : std_logic_vector(COUNT - 1 downto 0);
begin
    firmware : entity work.board port map (clk => clk, rx => rx, pins => pins);
    process
        type times is array (0 to 4095) of time;
        type bytes is array (0 to 4095) of std_logic_vector(9 downto 0);
        variable begins : times; variable coming : bytes;  -- a ring, with start and stop bits
        variable first, last, place, sending : natural := 0;
        variable said : line;
        variable word : string(1 to 2);
        variable digit : character;
        variable number, sample, until_at, edge, bit_time : time := 0 ns; variable period_at : time := PERIOD_NS * 1 ns;
        variable value : std_logic_vector(7 downto 0);
        variable sent : std_logic_vector(9 downto 0);
        variable level, shown : std_logic_vector(COUNT - 1 downto 0) := (others => '0');
        procedure tell(text : string) is
        begin
            write(output, text & LF);
        end procedure;
        impure function in_ns(t : time) return string is  -- more than an integer holds
            constant last_digits : string := integer'image(1000 + (t mod 1 us) / 1 ns);
        begin
            return integer'image(t / 1 us) & last_digits(2 to 4);
        end function;
        procedure tell_periods(up_to : time) is
        begin
            while up_to >= period_at loop
                tell("|");
                period_at := period_at + PERIOD_NS * 1 ns;
            end loop;
        end procedure;
        procedure run_clock is
        begin
            edge := now;
            if first /= last and edge >= begins(first) then
                place := minimum(10, (edge - begins(first)) / bit_time);
                rx <= '1' when place > 9 else coming(first)(place);
                first := (first + place / 10) mod 4096;
            end if;
            clk <= '1', '0' after HALF_CLOCK_PS * 1 ps;
            wait for HALF_CLOCK_PS * 1 ps;
            tell_periods(edge);
            for n in pins'range loop level(n) := '1' when pins(n) = '1' else '0'; end loop;
            if level /= shown then
                tell("P " & in_ns(edge + PERIOD_NS * 1 ns - period_at) & " " & to_hstring(level));
                shown := level;
            end if;
            if sending = 0 and tx = '0' then
                sending := 10;
                sample := edge + bit_time / 2;
            elsif sending /= 0 and edge >= sample then
                sample := sample + bit_time;
                sent := tx & sent(9 downto 1);
                sending := sending - 1;
                until_at := edge when sending = 0;
                if sending = 0 then tell("R " & in_ns(edge) & " " & to_hstring(sent(8 downto 1))); end if;
            end if;
            wait for HALF_CLOCK_PS * 1 ps;
        end procedure;
    begin
        while not endfile(input) loop
            readline(input, said);
            read(said, word);
            number := 0 ns;
            while said'length > 0 loop
                read(said, digit);
                exit when digit = ' ';
                number := number * 10 + (character'pos(digit) - character'pos('0')) * 1 ns;
            end loop;
            case word(1) is
                when 'L' =>
                    bit_time := number;
                    tell("hello 1" & LF & "by GHDL" & LF & "period " & to_string(PERIOD_NS));
                    write(output, "start " & to_string(START_NS) & LF & "pins");
                    for n in 0 to COUNT - 1 loop write(output, " pins" & to_string(n)); end loop;
                    tell(LF & ". 0");
                when 'B' =>
                    hread(said, value);
                    begins(last) := number;
                    coming(last) := '1' & value & '0';
                    last := (last + 1) mod 4096;
                when others =>
                    until_at := number;
                    while now <= until_at loop run_clock; end loop;
                    tell_periods(until_at);
                    tell(". " & in_ns(until_at));
            end case;
            flush(output);
        end loop;
        std.env.stop;
    end process;
end architecture;
